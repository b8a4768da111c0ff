"""The stages between source and socket, in order: merge, map, downsample, project, window, filter, publish."""
