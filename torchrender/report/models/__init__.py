"""Study: test models and procedural twins of well-known ones, each beside what it means."""
