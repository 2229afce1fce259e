"""What a record states of the engines, checked against their levers and the aircraft file."""
