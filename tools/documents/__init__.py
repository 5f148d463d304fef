"""What documents are made of: the page of all commands, and the site."""
