"""railctl, the command line: plans a cluster, supervises it, shows it. Starts services, never imports them."""
