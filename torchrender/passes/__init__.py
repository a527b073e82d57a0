"""The passes of a picture: one file each, and the table that lists them."""
