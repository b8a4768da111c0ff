"""The service: API, hub, web page, supervisor and command line."""
