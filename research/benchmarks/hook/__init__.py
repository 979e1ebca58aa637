"""The hook: the cost of a member, in the background, in blocks, over many members."""
