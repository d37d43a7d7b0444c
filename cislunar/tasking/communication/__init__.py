"""How measurements reach the common estimate, late and by contact, and what becomes of it then."""
