"""The report's experiment: repeated to the last digit, taken apart, and put right."""
