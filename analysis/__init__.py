"""The analysis of results: statistics of runs, learning curves judged, the report. It stands on `common` alone."""
