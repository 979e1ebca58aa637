"""Ablation: one scene, trained once per variant and seed in equal time, and judged on validation images."""
