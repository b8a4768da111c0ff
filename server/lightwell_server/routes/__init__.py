"""HTTP routes and WebSockets, one module a concern."""
