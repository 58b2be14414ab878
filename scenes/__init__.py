"""Runnable render comparisons: each makes or reads an input, completes it, renders it, compares it with the truth."""
