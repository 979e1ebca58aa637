"""How far a picture can be trusted: the stored truth, and what error to expect where there is none."""
