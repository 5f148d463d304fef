"""Pictures of levels and of moments of episodes, with Pillow; for whoever draws trains."""
