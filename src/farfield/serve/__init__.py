"""A world over HTTP (spec/http.md), with the viewer. Never imports bake."""
