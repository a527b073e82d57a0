"""Material style from a photo, measured."""
