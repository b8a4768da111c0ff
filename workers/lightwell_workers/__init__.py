"""The workers: capture-ingest, and the executors of long jobs."""
