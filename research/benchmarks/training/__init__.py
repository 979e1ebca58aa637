"""Training: budgets, curves, transfer functions, few views, volume fidelity."""
