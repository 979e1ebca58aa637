"""What each choice of training is worth: one scene, trained once per variant and seed in equal time, then judged."""
