"""Work on many recordings, in this process or others, kept in a journal."""
