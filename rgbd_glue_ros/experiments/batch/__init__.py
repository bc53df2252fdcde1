"""Work on many recordings, in this process or others, with a journal."""
