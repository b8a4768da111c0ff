"""The stages from source to socket, in order: merge, map, downsample, project, gradients, window, filter, publish."""
