"""What the page asks of the calculations: the same functions as the commands, the same JSON."""
