"""What `railctl doctor` looks at, a file for each part of a machine; docs/troubleshooting.md has every code."""
