"""Force models, and the propagation of states, bundles and transition matrices under them."""
