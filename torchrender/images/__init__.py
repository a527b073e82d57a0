"""Picture files in and out, always linear light in memory."""
