"""Questions of surgeons: a folder each, with its cases and the page that answers it."""
