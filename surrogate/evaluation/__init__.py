"""What the images that training never learnt from say of a surrogate, beside trivial predictors."""
