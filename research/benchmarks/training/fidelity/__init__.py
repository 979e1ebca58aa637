"""What limits the pictures of one volume made of Gaussians."""
