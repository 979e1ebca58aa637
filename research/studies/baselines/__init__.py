"""Published systems that learn pictures of ensembles, written anew from their papers and official codes, to be compared with."""
