"""Sessions in which the server decides what to send, over a WebSocket (spec/stream.md; BEN 5)."""
