from torchrender.report.walkthrough.study import main

if __name__ == "__main__":
    main()
