"""Model only what a scene needs: what is stored is chosen from the data, by what validation images say it is worth.

The colour degree is chosen during stage 2, what may be left out after it, and the precision at the end.  Every choice is made on
validation images, never on test ones, and says what it measured (`Choice`).
"""
