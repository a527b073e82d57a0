"""Materials for a scene from the colours of a photo: views, fitted candidates, and a choice among them."""
