"""The explorer's server: one page, the calls that it makes over a WebSocket, exports over HTTP, and who may ask at all."""
