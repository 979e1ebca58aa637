"""Hard cases for a splatting backend, each checked against the float64 reference implementation, and the drift of training."""
