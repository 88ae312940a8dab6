"""The reading of KRL programs (KUKA)."""
