"""Capture ingest: one process a stream that turns pictures of the light into coefficients and publishes them."""
