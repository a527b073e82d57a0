"""The room behind an indoor photo: camera and box from marked corners, furniture, lights."""
