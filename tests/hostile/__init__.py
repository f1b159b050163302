"""Files made by somebody who wishes us ill: what each reader makes of them, in bounded room and time."""
