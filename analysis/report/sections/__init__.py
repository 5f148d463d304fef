"""The sections of a report, in the study's order: each a function from results to text, figures and tables."""
