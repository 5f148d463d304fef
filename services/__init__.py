"""The processes of a run; strangers to each other, they meet on the wire only."""
