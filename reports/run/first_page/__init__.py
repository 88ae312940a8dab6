"""What the first page of a report says besides the offsets: what to do, and a rehearsal's truth."""
