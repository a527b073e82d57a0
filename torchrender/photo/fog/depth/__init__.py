"""Depth of photos: from labels, pictures, stereo, LiDAR and RGB-D cameras."""
