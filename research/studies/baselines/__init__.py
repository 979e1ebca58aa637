"""Published systems that learn images of ensembles, reimplemented from their papers and official codes for comparison."""
