"""What goes over the wire, for both sides: messages, compression, containers of keyframes."""
