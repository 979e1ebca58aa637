"""Limits of images of one volume made of Gaussians."""
