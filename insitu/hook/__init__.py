"""The hook for a simulation loop: `Session` and `render_member`."""
