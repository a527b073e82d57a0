"""What commands read and write: inputs that stay, by-products, files of depth images."""
