"""The hook for simulations in C, C++ and Fortran: a shared library with an interpreter in it (`insitu library`)."""
