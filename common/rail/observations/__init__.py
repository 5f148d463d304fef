"""What trains see: a module for each kind of observation, and `table` of all."""
