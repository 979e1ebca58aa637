"""What notebooks show: cards of facts and small pictures, as HTML."""
