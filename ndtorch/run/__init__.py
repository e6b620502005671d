"""What a command does with a source and a model: options, the loop over frames, folders of results."""
