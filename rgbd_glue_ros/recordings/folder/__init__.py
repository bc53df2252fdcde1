"""Folders of colour and depth images, in whatever way they are named and listed."""
