"""All-frequency shadows of moving objects under the sky: spheres that stand for objects, and the light they leave."""
