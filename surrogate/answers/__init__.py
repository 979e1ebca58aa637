"""Answers of a surrogate to questions: how sure it is of a picture, which parameters draw one, and which runs to simulate next."""
