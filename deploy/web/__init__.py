"""The page of `railctl watch`: a server on loopback that reads what runs publish and what lies in their folders."""
