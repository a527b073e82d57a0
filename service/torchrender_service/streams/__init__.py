"""Streams of keyframes: sessions, where the next keyframe is placed, when it is made."""
