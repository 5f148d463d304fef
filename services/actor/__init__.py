"""Acts leased episodes and publishes them."""
