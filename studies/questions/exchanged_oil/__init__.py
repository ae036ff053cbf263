"""How much oil an exchange leaves behind, and how long a cannula takes."""
