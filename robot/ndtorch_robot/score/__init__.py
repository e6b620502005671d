"""What a drive was worth: its record, figures, pictures and page."""
