"""Who may reach a bench from other computers: certificates, roles, and what each role may do."""
