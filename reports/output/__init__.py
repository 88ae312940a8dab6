"""Files out: HTML, PDF, the folder of a report, posterior.nc."""
