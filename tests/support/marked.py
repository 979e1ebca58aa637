"""Imported where processes are forked from, so that the mark of our code, half a second's work, is made once for all of them."""

from surrogate.provenance import code

code()
