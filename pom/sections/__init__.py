"""Parts of the HTML report: each module turns results into what one template or one figure shows."""
