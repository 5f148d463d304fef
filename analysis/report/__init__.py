"""The report on a study, or on any runs: one page with figures and tables, and all of them as files beside it."""
