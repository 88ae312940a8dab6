"""What a person sees of a history: lists, the page of an arm, the page of all arms, certificates."""
