"""A package, so that no other `tests` is taken for it: one of yt's dependencies installs one beside itself."""
