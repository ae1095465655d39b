"""What the pages show, without any widget: Qt objects that listen to ``polfuse_lab`` and tell of changes."""
