"""Folders of colour and depth images, with any naming and listing."""
