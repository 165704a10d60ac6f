"""The name under which mapod is installed: the build puts core, hw, app, tools and main in here."""
