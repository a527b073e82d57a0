"""Who may come in: connections, their deadlines, and how much one address may ask for."""
