"""What both ends of a wire share. Imports no service and no deployment code."""
