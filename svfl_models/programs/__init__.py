"""Reading and running of exported programs (``.pt2``) without unpickling anything."""
