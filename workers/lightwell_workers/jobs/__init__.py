"""Durable jobs: DBOS keeps the state, Dask does the work, files hold the checkpoints."""
