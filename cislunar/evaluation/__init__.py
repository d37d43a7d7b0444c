"""How good an estimate is, and how good it could be: metrics and the Cramer-Rao bound."""
