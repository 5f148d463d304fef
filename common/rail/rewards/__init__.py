"""What trains are paid for a step: a module for each kind of reward, and `table` of all."""
