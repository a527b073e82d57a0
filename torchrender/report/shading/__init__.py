"""What shading costs, beside torch and beside the machine's limit, and how much light it keeps."""
