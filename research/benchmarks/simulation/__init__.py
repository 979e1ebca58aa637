"""The bundled Taylor-Green solver."""
