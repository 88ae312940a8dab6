"""`zerobeam history`: a database of results of many arms over the years."""
