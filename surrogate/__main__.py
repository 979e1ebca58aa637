"""`python -m surrogate`, for `torchrun -m surrogate train`: the command line."""

from surrogate.cli import main

if __name__ == "__main__":
    main(prog_name="surrogate")
