"""Parts of the contact of two organs, `contact.Between`, and of several, `contact.Coupled`."""
