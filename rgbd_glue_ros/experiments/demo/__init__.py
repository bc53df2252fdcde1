"""The bundled recording, played into the node over DDS."""
