from trajopt.cli import main

main()
