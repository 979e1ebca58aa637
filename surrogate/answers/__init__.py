"""Answers of a surrogate to questions: how sure it is of a picture, and which runs to simulate next."""
