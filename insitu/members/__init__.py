"""One member: its request, its plan, its drawing, its result, and its failure."""
