"""Takes all the time that one core has."""

if __name__ == "__main__":
    while True:
        pass
